"""The mixture at a point: tissue, solid, electrochemistry, permeability, fluxes, and the three models made of them."""
