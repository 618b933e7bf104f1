"""A live viewer: robots that swim while their damage, sizes and water change."""
