"""Results of the benchmarks: what runs wrote as JSON, and the Markdown that is made from it."""
