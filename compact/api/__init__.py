"""Python interface for studies: a scene with its results as tables, figures and meshes; see `compact.api.scene`."""
