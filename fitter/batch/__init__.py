"""Many scenes by one command: which there are, who fits them, what is kept, and the summary of all."""
