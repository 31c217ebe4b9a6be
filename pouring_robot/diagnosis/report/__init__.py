"""A diagnosis for people and programs: sentences, figures, page, scene, and the folder to which they are written."""
