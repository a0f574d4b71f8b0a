"""What would a real robot do? Its readings, its moves, its errors."""
