"""Integration of LinuxCNC: a robot's table and configuration for the components in deploy/."""
