"""What each program does in a comparison; every file runs in a process of its own, with that program's Python."""
