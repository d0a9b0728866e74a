"""Result files: fields and their metadata, writing, reading, where they come from, other formats."""
