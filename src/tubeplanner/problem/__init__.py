"""The planning problem: robot, tube, start, goal, obstacles; read from files and checked."""
