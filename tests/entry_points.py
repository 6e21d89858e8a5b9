"""A tiny distribution whose entry points offer engines or drives."""


def install(folder, module, source, group, **points):
    """Write a module, its distribution and the entry points of a group, name by object of the module."""
    (folder / f"{module}.py").write_text(source)
    facts = folder / f"{module}-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module.replace('_', '-')}\nVersion: 1.0\n")
    lines = [f"{name} = {module}:{target}\n" for name, target in points.items()]
    (facts / "entry_points.txt").write_text("".join([f"[{group}]\n", *lines]))
