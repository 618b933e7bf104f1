"""Infrastructure of commands: options, help, folders with manifests, jobs, workers, progress.

Environments import none of it.
"""
