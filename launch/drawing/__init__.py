"""The wiring of a graph as a picture: layers, places, SVG."""
