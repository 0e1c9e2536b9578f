"""Speed, measured beside plain numpy and peers in one run: `make bench`."""
