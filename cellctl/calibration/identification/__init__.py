"""From a task and its rows to the identified robot: inliers, registration, fit, noise, number of terms."""
