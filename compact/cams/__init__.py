"""The cam of constant breadth: profile, followers, machining, drawings, files."""
