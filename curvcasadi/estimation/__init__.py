"""Shapes from measurements: filters, fits, and where sensors should sit."""
