"""How controllers are searched for.

A search is a generator: it asks, with a :class:`~gait.search.asking.Ask`, how good some controllers
are, is sent the answer, and asks again, without end. So it knows neither bodies nor files, and
whoever remembers the answers can bring it back to where it was.
"""
