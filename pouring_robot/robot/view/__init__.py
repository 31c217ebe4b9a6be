"""The robot in the viewer: scenes of nominal and actual poses, and a bench whose sliders move it."""
