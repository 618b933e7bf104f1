"""Real robots in public logs: what each can be told from its own log.

Each module reads one data set, states its robot and evaluates what is inferred. The data stay
where the user has put them.
"""
