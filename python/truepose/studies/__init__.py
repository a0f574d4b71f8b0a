"""What holds for many robots? One question asked of each, here or on a cluster."""
