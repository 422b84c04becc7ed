"""What is predicted: bodies, environment, materials, uncertain parameters, what is believed of them, and
scene files.
"""
