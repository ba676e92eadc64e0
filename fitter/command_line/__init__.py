"""What commands share: options, choices, output, progress."""
