"""The step: of material points, of finite elements, in statics and dynamics."""
