"""The parts of ``damage_recovery.py``: the treatments, their statistics, figures and report."""
