"""Recordings in the formats of Foxglove and Rerun, and topics in a ROS 2 graph.

Optional: formats are found by their entry points, and imported by nothing else.
"""
