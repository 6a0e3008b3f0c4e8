"""The paper's demonstrations."""
