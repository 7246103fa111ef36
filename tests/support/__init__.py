"""Plants, problems and judges that the tests of several rooms share."""
