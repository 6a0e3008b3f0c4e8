"""Report about a printer, or about a part on it, to its owner: pages in HTML and PDF."""
