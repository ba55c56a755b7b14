//! Trains, evaluates and simulates neural muscle fields; holds the program myofield
