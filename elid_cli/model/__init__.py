"""The model: kinematics, regressor, base parameters, dynamics, terms and effects."""
