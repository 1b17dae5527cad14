"""Kit's namespace."""
