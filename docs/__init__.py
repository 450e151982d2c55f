"""The documentation site: its pages, its pictures, and what runs the code on its pages."""
