//! Modulated SIREN networks that map a latent code and a point to an actuation, with a fused kernel and exact gradients
