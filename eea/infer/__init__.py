"""Joint inference: parameters, nuisances and hidden angles of all trials in one least-squares fit.

It knows no robot and needs numpy and scipy only. ``eea`` has its public names.
"""
