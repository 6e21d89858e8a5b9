"""The cart and its drives: rigid, crank, elastic, motor, hydraulic; ranking of motion laws."""
