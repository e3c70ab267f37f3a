<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology|Labeling|Fields|Forms|MapTips" labelsEnabled="0">
 <renderer-v2 type="categorizedSymbol" attr="CASE WHEN &quot;settled_bits_per_km&quot; &gt;= 5 THEN 'much' WHEN &quot;settled_bits_per_km&quot; &gt;= 1 THEN 'some' ELSE 'little' END" symbollevels="0" forceraster="0" enableorderby="0">
  <categories>
   <category symbol="0" value="much" label="5 bit a km and more" render="true" />
   <category symbol="1" value="some" label="1 to 5 bit a km" render="true" />
   <category symbol="2" value="little" label="Under 1 bit a km" render="true" />
  </categories>
  <symbols>
   <symbol type="line" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="213,94,0,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="1.4" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="213,94,0,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="1.4" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="line" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="230,159,0,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="1" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="230,159,0,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="1" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="line" name="2" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="143,147,160,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="0.5" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="143,147,160,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="0.5" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <fieldConfiguration />
 <aliases>
  <alias field="road_id" index="1" name="Road and kommune" />
  <alias field="road" index="2" name="Road" />
  <alias field="kommune" index="3" name="Kommune" />
  <alias field="km" index="4" name="Length (km)" />
  <alias field="n_places" index="5" name="Signs" />
  <alias field="n_unsure" index="6" name="Unsure signs" />
  <alias field="n_not_passed" index="7" name="Signs that no drive has passed" />
  <alias field="unsure_bits" index="8" name="How unsure (bit)" />
  <alias field="settled_bits" index="9" name="What a drive settles (bit)" />
  <alias field="settled_bits_per_km" index="10" name="What a drive settles a km (bit/km)" />
 </aliases>
 <editable>
  <field name="fid" editable="0" />
  <field name="road_id" editable="0" />
  <field name="road" editable="0" />
  <field name="kommune" editable="0" />
  <field name="km" editable="0" />
  <field name="n_places" editable="0" />
  <field name="n_unsure" editable="0" />
  <field name="n_not_passed" editable="0" />
  <field name="unsure_bits" editable="0" />
  <field name="settled_bits" editable="0" />
  <field name="settled_bits_per_km" editable="0" />
 </editable>
 <previewExpression>"road"</previewExpression>
 <mapTip enabled="1">&lt;b&gt;[% coalesce(nullif(replace(replace("road", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/b&gt; &amp;nbsp; [% coalesce(nullif(replace(replace("kommune", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]
&lt;br&gt;one more drive settles [% coalesce(to_string(round("settled_bits", 2)) || ' bit', '–') %], [% coalesce(to_string(round("settled_bits_per_km", 2)) || ' bit', '–') %] a km of [% coalesce(to_string(round("km", 1)) || ' km', '–') %]
&lt;br&gt;[% coalesce(to_string(round("n_places", 0)) || '', '–') %] signs, [% coalesce(to_string(round("n_unsure", 0)) || '', '–') %] unsure, [% coalesce(to_string(round("n_not_passed", 0)) || '', '–') %] that no drive has passed</mapTip>
</qgis>
