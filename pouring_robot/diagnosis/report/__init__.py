"""A diagnosis for people and programs: sentences, figures, page, scene, and the folder they are written to."""
