"""Where sensors should sit."""
