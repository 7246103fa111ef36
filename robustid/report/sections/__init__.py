"""One builder a subject: each says and draws its part of a page, and of the summary at the terminal."""
