"""The reality-gap suite: every method in worlds that its models do not know, with new damages.

``worlds`` has the worlds and the damages, ``job`` does one method in one of them, ``rivals`` are
two general optimisers, ``report`` counts, ``figures`` draws, and ``command`` joins them.
"""
