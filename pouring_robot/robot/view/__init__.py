"""The robot as the viewer shows it: scenes of where it stands and should stand, and a bench whose sliders move it."""
