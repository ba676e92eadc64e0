"""The viewer's picture in torch."""
