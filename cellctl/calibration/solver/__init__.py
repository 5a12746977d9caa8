"""The most probable parameters of a problem, their covariance, and the scales of noise and priors by evidence."""
