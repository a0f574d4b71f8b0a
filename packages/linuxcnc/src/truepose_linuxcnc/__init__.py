"""LinuxCNC: robot tables and configurations for the HAL components in packages/linuxcnc/hal."""
