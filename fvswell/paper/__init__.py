"""The reproduction of Wilson, van Donkelaar & Huyghe (2005): a client of the library."""
