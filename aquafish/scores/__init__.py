"""Reference scores: what simple, evolved and learned controllers are worth at every task."""
