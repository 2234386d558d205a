"""What is asked: robot, tube, start, goal, obstacles; read from files and checked."""
