"""Fields of skeletons, and what is made of them."""
