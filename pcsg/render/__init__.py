"""From rays to pictures: camera, light, film, files."""
