"""What is shown: the scene drawn in float, its layers, tones, and what is measured under the cursor."""
