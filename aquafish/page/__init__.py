"""A page in which the fish swims, breaks, works out what it has become, and swims on.

It is one HTML file without a server: the physics is printed in JavaScript from the functions that
everything else runs, and the agent is written once more, in ``agent.js``.
"""

from aquafish.page.document import live_page, write_live_page

__all__ = ["live_page", "write_live_page"]
