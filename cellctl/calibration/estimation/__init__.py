"""From a task and its rows to the most probable parameters, their covariance and the noise."""
