"""Integration of LinuxCNC: robot tables and configurations for the components in deploy/."""
