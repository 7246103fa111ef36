"""Linear certificates: values of every consistent system from finitely many sums, without a semidefinite program."""
