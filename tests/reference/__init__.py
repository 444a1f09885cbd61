"""Independent reference at 50 digits: the paper's motion, the comparison motion and the Delta robot.

It shares no code with the product and reaches its numbers by other routes: root finding on definitions,
quadrature, Taylor arithmetic in time and virtual work of point masses. SI units throughout.
"""
