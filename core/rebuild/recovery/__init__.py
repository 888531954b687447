"""From points to a superquadric: size, exponents, pose, taper and bend."""
