"""Pictures of the cracked plate."""
