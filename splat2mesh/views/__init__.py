"""Where to look from: trained cameras, virtual views, and which way is up."""
