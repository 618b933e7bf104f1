"""What steers a robot: networks, controllers, other policies and agents, and controllers in C."""
