"""Statistics of joint inference that know no robot: densities in boxes, noise, goodness of fit."""
