"""What is a robot? Its kinematics, its readings, what is known of it."""
