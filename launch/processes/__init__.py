"""Starting the processes of a graph, watching them, and leaving nothing behind."""
