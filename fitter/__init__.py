"""From photographs to a material: residuals, solver, uncertainty, files, report, command line."""
