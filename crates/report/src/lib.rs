//! Headless pictures of surfaces, comparison sheets and plots
