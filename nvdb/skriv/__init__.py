"""API Skriv: log in, send change sets, and follow what becomes of them."""
