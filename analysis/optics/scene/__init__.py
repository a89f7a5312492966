"""One design in one state: parameters, centrelines, outline as lines and arcs, BVH."""
