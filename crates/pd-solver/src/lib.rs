//! Quasi-static equilibria of actuated soft bodies, and their exact adjoint
