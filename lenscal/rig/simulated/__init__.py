"""A simulated rig that obeys the physics: behind the interfaces of a real one, with a truth to ask."""
