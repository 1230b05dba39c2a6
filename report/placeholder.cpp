// Placeholder: delete with the first real source.
