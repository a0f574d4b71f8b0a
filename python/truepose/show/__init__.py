"""How is it shown? Tables, pages, drawings, the terminal."""
