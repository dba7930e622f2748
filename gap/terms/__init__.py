"""Terms for a gap that no known effect fits: a sparse correction of one stage's signal, proposed, tested and saved."""
