"""HTTP to NVDB: one GET with retries, a rate limit and a deadline, and the one paging loop."""
