"""What an image shows before anyone asks what was printed: its scale and frame, rulers, paper, tags, outlines."""
