"""Optimising designs: from a bore and what must be seen to a design and a parts list, or to what stands in the way.

`study.load_study` reads a file that poses a `problem.DesignProblem` (variables, constraints, goals); `solve.solve`
finds the best design from many starts and says how far to trust it, or names the smallest set of limits that cannot
hold together and what would relax it. `study.run` does everything that a file asks for: reduce a bore to one stop,
trace a front, make a design robust, choose parts.
"""
