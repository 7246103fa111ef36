"""One live page: the response with its bounds, and a class that is changed by hand while margin, band and verdict follow."""
