"""Tables of named entries: open for tests, closed for users."""
