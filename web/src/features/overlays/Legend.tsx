// The classes of an overlay by color, hatching and name, with how many cells have each where that is known.

import type { ClassStyle } from "../../scene/palette";
import { Swatch } from "../../ui/Swatch";

export function Legend(props: { styles: ClassStyle[]; counts?: Record<number, number> }) {
  const { styles, counts = {} } = props;
  return (
    <ul className="legend">
      {styles.map((style) => (
        <li key={style.value} className="row">
          <Swatch style={style} />
          {style.name}
          {counts[style.value] !== undefined && (
            <span className="num quiet" data-testid={`legend-count-${style.value}`} title="Cells">
              {counts[style.value]}
            </span>
          )}
        </li>
      ))}
    </ul>
  );
}
