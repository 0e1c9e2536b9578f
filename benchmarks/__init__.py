"""How fast the commands are: as processes, inside, beside other programs, and beside another revision."""
