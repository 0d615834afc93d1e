"""Health of each camera: its rate, its losses, its stamps and its pictures, in constant memory."""
