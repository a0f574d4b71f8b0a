"""Integration of MuJoCo: models, a plant with rigid bodies, a viewer."""
