"""Wrong input as one sentence, and text of strangers made safe to print."""
