"""What commands need: options and help, folders with manifests, jobs, workers and progress.

Environments import none of it.
"""
