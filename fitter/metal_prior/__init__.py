"""What a catalogue of metals contributes where photographs leave n and k open."""
