"""Templates of pages, and plots."""
