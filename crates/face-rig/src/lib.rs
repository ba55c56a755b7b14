//! Mandible joint with derivatives, and blendshape weights by bounded least squares
