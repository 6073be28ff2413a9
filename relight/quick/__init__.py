"""A first relit picture of a capture within seconds, before its mesh: coarse places of the splats, shadowed by the
opacity of space."""
