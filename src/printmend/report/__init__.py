"""What is known of a printer, or of a part on it, as a document for its owner: pages in HTML and PDF."""
