"""What training looks at: views, pixels, the light of brackets, the truth where there is one."""
