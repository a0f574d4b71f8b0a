"""What do a 3D printer's own file and its readings say of it? Klipper's delta printers."""
