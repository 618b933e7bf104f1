"""Recorders' logs: what is in a file, and its columns on one clock. No robot is known here."""
