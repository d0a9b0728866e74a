"""Case files: what they may say, how they are read and checked, and what is reported of wrong ones."""
