"""Contact geometry: sphere trees, shapes, broad and narrow phase, patches of contacts."""
