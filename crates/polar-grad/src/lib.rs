//! 3x3 signed SVD, polar rotation and its exact derivative, and the spectrum of shape-targeting energies
